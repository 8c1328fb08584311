"""What a step costs: sums and products by formula, and counted on the code as it runs.

Formulas are for dense matrices, as the tracker paper's Table I takes them: a product of an a x b
and a b x c matrix costs a b c products and a (b - 1) c sums. Counting hands the running code
numbers of type `Counted`, which add themselves up in a `Tally` whenever they are used.
"""

import math
import operator
from dataclasses import dataclass

import numpy as np


@dataclass
class Tally:
    """Operations counted so far; comparisons and sign changes are free, as in the paper's table."""

    sums: int = 0
    products: int = 0
    divisions: int = 0
    functions: int = 0  # square roots, sines, arctangents

    @property
    def total(self):
        """All of them."""
        return self.sums + self.products + self.divisions + self.functions

    def __add__(self, other):
        """Add up kind by kind."""
        return Tally(*(a + b for a, b in zip(self.counts(), other.counts(), strict=True)))

    def counts(self):
        """Sums, products, divisions, functions."""
        return self.sums, self.products, self.divisions, self.functions


def matrix_product(a, b, c):
    """Count an a x b matrix times a b x c one.

    Returns
    -------
    Tally
    """
    return Tally(sums=a * (b - 1) * c, products=a * b * c)


def predict(n, p, *, input_matrix=True):
    """Count one Kalman prediction with dense matrices. ::

        x = A x + B u          P = A P A' + Q

    Parameters
    ----------
    n, p : int
        Sizes of state and input; p = 0 if there is none.
    input_matrix : bool
        Multiply the input by B; else it is added as it is (then p = n).

    Returns
    -------
    Tally
    """
    state = matrix_product(n, n, 1) + Tally(sums=n if p else 0)
    if p and input_matrix:
        state += matrix_product(n, p, 1)
    return state + matrix_product(n, n, n) + matrix_product(n, n, n) + Tally(sums=n * n)


def update(n, m):
    """Count one Kalman update as textbooks write it, with dense matrices. ::

        y = z - H x     S = H P H' + R     K = P H' inv(S)     x = x + K y     P = (I - K H) P

    Parameters
    ----------
    n, m : int
        Sizes of state and measurement.

    Returns
    -------
    Tally
    """
    innovation = matrix_product(m, n, 1) + Tally(sums=m)
    S = matrix_product(m, n, n) + matrix_product(m, n, m) + Tally(sums=m * m)
    gain = matrix_product(n, n, m) + cholesky_inverse(m) + matrix_product(n, m, m)
    state = matrix_product(n, m, 1) + Tally(sums=n)
    covariance = matrix_product(n, m, n) + Tally(sums=n * n) + matrix_product(n, n, n)
    return innovation + S + gain + state + covariance


def lean_update(n, m):
    """Count the update of `analysis.tracker.kalman`: nothing is multiplied out twice. ::

        K = (H P)' inv(H P H' + R)     P = P - K (H P), then the mean of P and its transpose

    Parameters
    ----------
    n, m : int

    Returns
    -------
    Tally
    """
    state = matrix_product(m, n, 1) + matrix_product(n, m, 1) + Tally(sums=m + n)
    S = matrix_product(m, n, n) + matrix_product(m, n, m) + Tally(sums=m * m)
    gain = ldl_inverse(m) + matrix_product(n, m, m)
    covariance = matrix_product(n, m, n) + Tally(sums=2 * n * n, products=n * n)
    return state + S + gain + covariance


def cholesky_inverse(m):
    """Count the inverse of a symmetric m x m matrix: S = L L', inv(L), inv(L)' inv(L).

    Returns
    -------
    Tally
    """
    third = (m**3 - m) // 6
    factor = Tally(sums=third, products=third, divisions=m * (m - 1) // 2, functions=m)
    triangle = Tally(
        sums=(m**3 - 3 * m**2 + 2 * m) // 6, products=third, divisions=m * (m + 1) // 2
    )
    return factor + triangle + Tally(sums=third, products=third + m * (m + 1) // 2)


def ldl_inverse(m):
    """Count the inverse by S = L D L', without square roots, as `analysis.tracker.kalman` does it.

    Returns
    -------
    Tally
    """
    pairs, triples = m * (m - 1) // 2, (m**3 - 3 * m**2 + 2 * m) // 6
    squares = (m - 1) * m * (2 * m - 1) // 6
    factor = Tally(sums=triples + pairs, products=triples + 2 * pairs, divisions=m)
    return factor + Tally(sums=squares, products=squares + pairs)


def buffer_mean(length, axes=1):
    """Count the mean of a buffer from scratch, the worst case: one division an axis.

    Returns
    -------
    Tally
    """
    return Tally(sums=axes * (length - 1), divisions=axes)


def _counting(kind, operate, *, swapped=False):
    """Make an operator of `Counted` that counts itself."""

    def method(self, other):
        pair = (float(other), self.value) if swapped else (self.value, float(other))
        return self.result(operate(*pair), kind)

    return method


def _comparing(operate):
    """Make a comparison of `Counted`, which costs nothing."""
    return lambda self, other: operate(self.value, float(other))


class Counted:
    """A number that counts the operations done with it.

    Parameters
    ----------
    value : float
    tally : Tally
        Where they are counted; results of operations keep it.
    """

    __slots__ = ("tally", "value")
    __hash__ = None

    def __init__(self, value, tally):
        self.value, self.tally = float(value), tally

    def result(self, value, kind):
        """Count one operation and wrap what it gave."""
        setattr(self.tally, kind, getattr(self.tally, kind) + 1)
        return Counted(value, self.tally)

    __add__ = __radd__ = _counting("sums", operator.add)
    __sub__ = _counting("sums", operator.sub)
    __rsub__ = _counting("sums", operator.sub, swapped=True)
    __mul__ = __rmul__ = _counting("products", operator.mul)
    __truediv__ = _counting("divisions", operator.truediv)
    __rtruediv__ = _counting("divisions", operator.truediv, swapped=True)
    __mod__ = _counting("divisions", operator.mod)
    __lt__, __le__ = _comparing(operator.lt), _comparing(operator.le)
    __gt__, __ge__ = _comparing(operator.gt), _comparing(operator.ge)
    __eq__ = _comparing(operator.eq)

    def __pow__(self, exponent):
        """Square by a product, else by a function."""
        if exponent == 2:
            return self * self
        return self.result(self.value**exponent, "functions")

    def __neg__(self):
        """Change the sign, which costs nothing."""
        return Counted(-self.value, self.tally)

    def __abs__(self):
        """Drop the sign, which costs nothing."""
        return Counted(abs(self.value), self.tally)

    def __float__(self):
        """Leave the counting: what is done with a plain float is not seen."""
        return self.value

    # numpy calls these by name on arrays of objects.
    def sqrt(self):
        """Take the square root."""
        return self.result(math.sqrt(self.value), "functions")

    def sin(self):
        """Take the sine."""
        return self.result(math.sin(self.value), "functions")

    def cos(self):
        """Take the cosine."""
        return self.result(math.cos(self.value), "functions")

    def arctan2(self, other):
        """Take the angle of (other, self)."""
        return self.result(math.atan2(self.value, float(other)), "functions")

    def hypot(self, other):
        """Take the length of (self, other)."""
        return self.result(math.hypot(self.value, float(other)), "functions")


def counted(array, tally):
    """Turn an array of numbers into `Counted` ones.

    Parameters
    ----------
    array : array_like
    tally : Tally

    Returns
    -------
    ndarray of object, of the same shape
    """
    array = np.asarray(array, dtype=float)
    out = np.empty(array.shape, dtype=object)
    out.ravel()[:] = [Counted(x, tally) for x in array.ravel()]
    return out


def instrument(block, tally):
    """Make a block of the tracker count: every number in its attributes becomes a `Counted`.

    What it hands to `math` (a root, a sine) leaves the counting, and is not seen.

    Parameters
    ----------
    block : object
        Changed in place, and so are the blocks inside it.
    tally : Tally

    Returns
    -------
    object
        The block.
    """
    for name, value in list(vars(block).items()):
        if hasattr(value, "__dict__") and type(value).__module__.startswith("analysis.tracker"):
            instrument(value, tally)
        else:
            setattr(block, name, _instrumented(value, tally))
    return block


def _instrumented(value, tally):
    if isinstance(value, np.ndarray):
        return counted(value, tally)
    if isinstance(value, float | np.floating):
        return Counted(value, tally)
    if isinstance(value, list | tuple):
        return type(value)(_instrumented(v, tally) for v in value)
    return value
