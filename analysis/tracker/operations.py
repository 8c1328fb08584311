"""The cost of a step: sums and products by formula, and counted on the code as it runs.

Formulas are for dense matrices, as the tracker paper's Table I takes them: a product of an a x b
and a b x c matrix costs a b c products and a (b - 1) c sums. To count, the running code is given
numbers of type `Counted`, which add each operation to a tally: a `collections.Counter` of sums,
products, divisions and functions (square roots). Comparisons and sign changes are free, as in the
paper's table.
"""

import copy
import operator
from collections import Counter, deque

import numpy as np
import pandas as pd

from analysis.tracker import kalman
from analysis.tracker.at_rest import BLOCK_S, LowPass, RestDetector, StaticTest
from analysis.tracker.attitude import Attitude, Upright
from analysis.tracker.constrained import STEP_S, Constrained
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import LastPosition
from analysis.tracker.mounting import MountingYaw
from analysis.tracker.vectors import STANDARD_GRAVITY

FOR_CARS = "6, for cars"  # the filter that may run in the place of block 6
KINDS = ("sums", "products", "divisions", "functions")


def dense(products, added):
    """Count products of matrices, each a x b times b x c, and sums of so many entries."""
    sums = added + sum(a * (b - 1) * c for a, b, c in products)
    return Counter(sums=sums, products=sum(a * b * c for a, b, c in products))


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
    Counter
    """
    by_B = [(n, p, 1)] if p and input_matrix else []
    return dense([(n, n, 1), *by_B, (n, n, n), (n, n, n)], n * n + (n if p else 0))


def update(n, m):
    """Count one Kalman update as textbooks write it, with dense matrices. ::

        y = z - H x     S = H P H' + R     K = P H' inv(S)     x = x + K y     P = (I - K H) P

    Parameters
    ----------
    n, m : int
        Sizes of state and measurement.

    Returns
    -------
    Counter
    """
    innovation, S = [(m, n, 1)], [(m, n, n), (m, n, m)]
    gain, state, covariance = [(n, n, m), (n, m, m)], [(n, m, 1)], [(n, m, n), (n, n, n)]
    added = m + m * m + n + n * n
    return dense(innovation + S + gain + state + covariance, added) + cholesky_inverse(m)


def cholesky_inverse(m):
    """Count the inverse of a symmetric m x m matrix: S = L L', inv(L), inv(L)' inv(L).

    Returns
    -------
    Counter
    """
    third = (m**3 - m) // 6
    factor = Counter(sums=third, products=third, divisions=m * (m - 1) // 2, functions=m)
    triangle = Counter(sums=m * (m - 1) * (m - 2) // 6, products=third, divisions=m * (m + 1) // 2)
    return factor + triangle + Counter(sums=third, products=third + m * (m + 1) // 2)


def _operator(kind, operate, *, swapped=False):
    """Make an operator of `Counted` that counts itself."""

    def method(self, other):
        pair = (float(other), self.value) if swapped else (self.value, float(other))
        self.tally[kind] += 1
        return Counted(operate(*pair), self.tally)

    return method


def _comparing(operate):
    """Make a comparison of two, which costs nothing either."""
    return lambda self, other: operate(self.value, float(other))


class Counted:
    """A number that counts the operations done with it.

    Parameters
    ----------
    value : float
    tally : Counter
        Where they are counted; results of operations keep it.
    """

    __slots__ = ("tally", "value")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value, tally):
        self.value, self.tally = float(value), tally

    __add__ = __radd__ = _operator("sums", operator.add)
    __sub__ = _operator("sums", operator.sub)
    __rsub__ = _operator("sums", operator.sub, swapped=True)
    __mul__ = __rmul__ = _operator("products", operator.mul)
    __truediv__ = _operator("divisions", operator.truediv)
    __rtruediv__ = _operator("divisions", operator.truediv, swapped=True)
    __mod__ = _operator("divisions", operator.mod)
    __lt__, __le__ = _comparing(operator.lt), _comparing(operator.le)
    __gt__, __ge__ = _comparing(operator.gt), _comparing(operator.ge)
    __eq__ = _comparing(operator.eq)

    def __neg__(self):
        """Change the sign, which costs nothing."""
        return Counted(-self.value, self.tally)

    def __pow__(self, exponent):
        """Square, by a product; the blocks take no other power."""
        return self * self if exponent == 2 else NotImplemented

    def __float__(self):
        """Return a plain float: operations on it are not counted."""
        return self.value


def counted(value, tally):
    """Turn a number, or those of an array or a sequence, into `Counted` ones.

    Parameters
    ----------
    value : float, ndarray or sequence of these
        Anything else stays as it is.
    tally : Counter

    Returns
    -------
    Counted, ndarray of object, or sequence
        Of the same shape.
    """
    if isinstance(value, np.ndarray):
        return np.frompyfunc(lambda x: Counted(x, tally), 1, 1)(value)
    if isinstance(value, float | np.floating):
        return Counted(value, tally)
    if isinstance(value, list | tuple | deque):
        make = getattr(type(value), "_make", type(value))
        return make(counted(v, tally) for v in value)
    return value


def instrument(block, tally):
    """Make a block of the tracker count: every number in its attributes becomes a `Counted`.

    What it passes to `math` (a root, a sine) is not counted.

    Parameters
    ----------
    block : object
        Changed in place, and so are the blocks inside it.
    tally : Counter

    Returns
    -------
    object
        The block.
    """
    thresholds = {k: v for k, v in vars(type(block)).items() if isinstance(v, float)}
    for name, value in (thresholds | vars(block)).items():
        if hasattr(value, "__dict__") and type(value).__module__.startswith("analysis.tracker"):
            instrument(value, tally)
        else:
            setattr(block, name, counted(value, tally))
    return block


def filter_costs(n: int, m: int, p: int, *, input_matrix: bool) -> dict[str, dict[str, Counter]]:
    """Count one prediction and one update of a Kalman filter, by formula and as it runs here.

    Parameters
    ----------
    n, m, p : int
        Sizes of state, measurement and input.
    input_matrix : bool
        Multiply the input by B; else add it.

    Returns
    -------
    dict of dict of Counter
        ``formula`` (`predict`, `update`) and ``counted`` (`kalman`) ->
        ``Predict`` and ``Update``.
    """
    first, second = Counter[str](), Counter[str]()
    x, P, F, Q, u, B = (counted(np.ones(s), first) for s in (n, (n, n), (n, n), (n, n), p, (n, p)))
    kalman.predict(x, P, F, Q, u, B if input_matrix else None)
    x, P, z, H, R = (
        counted(a, second) for a in (np.ones(n), np.eye(n), np.ones(m), np.eye(n)[:m], np.eye(m))
    )
    kalman.update(x, P, z, H, R)
    by_formula = predict(n, p, input_matrix=input_matrix)
    return {
        "formula": {"Predict": by_formula, "Update": update(n, m)},
        "counted": {"Predict": first, "Update": second},
    }


def block_costs(rate: float = 40.0) -> pd.DataFrame:
    """Count every step of every block on numbers that count themselves.

    The counts do not depend on the values, only on which branch is taken: a moving device with a
    course, a known mounting angle and a fix at each epoch; at rest for block 4.

    Parameters
    ----------
    rate : float
        Samples of the IMU a second.

    Returns
    -------
    pandas.DataFrame
        A row for each (block, step): ``sums``, ``products``, ``divisions``, ``functions``, their
        ``total``, and ``times_a_second``: samples at `rate`, fixes once, a straight once its buffer
        is full, a layer as often as it fills.
    """
    dt, here = 1 / rate, (1.0, 2.0)
    motion = (0.0, 0.0, 0.1), (0.3, 0.0, -STANDARD_GRAVITY), dt
    driven = _after(StaticTest().drive, [(3.0,)] * (StaticTest.speed_window - 1))
    told = 2.0, 5.0, 0.3, 3, 8
    fixes = [(float(k), (44.0 + 4.5e-5 * k, 11.0, 0.0), *told) for k in range(20)]
    fixed = _after(LastPosition().step, fixes)
    settled = _after(LowPass(lengths=(1,)).step, [(here,)]).__self__
    straight, entry = _mounting()
    steps = [
        ("1", "fix", 1.0, _count(fixed, 20.0, (44.0009, 11.0, 0.0), *told)),
        ("2", "fix", 1.0, _count(under_way(dt).epoch, False, 0.31, 0.05)),
        ("2", "sample", rate, _count(under_way(dt).imu, *motion, read="horizontal")),
        ("4", "fix", 1.0, _count(settled.jumped, here)),
        ("3", "fix", 1.0, _count(driven, 3.0)),
        ("3", "sample", rate, _count(StaticTest().accelerate, 0.3, 0.1, dt)),
        ("3", "sample for a 0.25 s mean", rate, _count(RestDetector().sample, *motion)),
        ("3", "window of 0.25 s means", 1 / BLOCK_S, _window(motion)),
    ]
    every = np.cumprod(LowPass.lengths)
    for k, times in enumerate(1 / every - np.append(1 / every[1:], 0.0)):
        block = LowPass(jump_m=np.inf)
        filling = _after(block.step, [(here,)] * (every[k] - 1))
        steps.append(("4", f"fix that fills layer {k + 1}", times, _count(filling, here)))
    fix = (0.1, 0.0, 0.0), (1.0, 0.0), 3.0, 0.3
    steps += [
        ("5", "fix", 1.0, entry),
        ("5", "straight", 1 / MountingYaw.straight_length, straight),
        ("6", "fix", 1.0, _count(_fusion(dt).update, *fix)),
        ("6", "sample", rate, _count(_fusion(dt).predict, (0.1, 0.0, 0.0), dt, 0.3)),
        *_car(motion, rate),
    ]
    blocks, names, times, tallies = zip(*steps, strict=True)
    index = pd.MultiIndex.from_arrays([blocks, names], names=["block", "step"])
    table = pd.DataFrame(tallies, index, KINDS).fillna(0).astype(int)
    return table.assign(total=table.sum(axis=1), times_a_second=times)


def under_way(dt):
    """Make an attitude block that knows all it can: level, heading, bias.

    Parameters
    ----------
    dt : float
        Between IMU samples, s.

    Returns
    -------
    Attitude
    """
    block = Attitude()
    for _ in range(round(3 / dt)):
        block.imu((0.0, 0.0, 0.1), (0.0, 0.0, -STANDARD_GRAVITY), dt)
    for _ in range(2):
        block.epoch(False, 0.3, 0.05)
        block.imu((0.0, 0.0, 0.1), (0.3, 0.0, -STANDARD_GRAVITY), dt)
    return block


def _count(step, *values, read=None):
    """Count one step, a bound method of a block, and a property read after it."""
    tally, block = Counter(), step.__self__
    instrument(block, tally)
    step(*counted(values, tally))
    if read:
        getattr(block, read)
    return tally


def _after(step, inputs):
    """Return a step, a bound method of a block, after it was called with some inputs."""
    for values in inputs:
        step(*values)
    return step


def _window(motion):
    """Count the sample that ends a window of 0.25 s means, without the sums of any sample."""
    block = RestDetector()
    while len(block._means) < block.rest_blocks:
        before = copy.deepcopy(block)
        block.sample(*motion)
    return _count(before.sample, *motion) - _count(RestDetector().sample, *motion)


def _car(motion, rate):
    """Count the constrained filter: a sample, a step of its covariance, a fix."""
    dt, under = motion[2], under_way(motion[2])
    block = Constrained()
    block.start((0.1, 0.2), (5.0, 0.1), (under.C_nb, under.bias.x, under.down), 0.1, 3.0, 0.3)
    sample = _count(copy.deepcopy(block).sample, *motion)
    for _ in range(round(STEP_S / dt) - 1):
        block.sample(*motion)
    step = _count(copy.deepcopy(block).sample, *motion) - sample
    fix = _count(block.reach, dt) + _count(block.update, (0.3, 0.1, 0.0), (5.0, 0.1), 3.0, 0.3)
    found = ("sample", rate, sample), ("step of P", 1 / STEP_S, step), ("fix", 1.0, fix)
    return [(FOR_CARS, *each) for each in found]


def _mounting():
    """Count the fix that completes a straight, and one before it."""
    tally = Counter()
    upright = Upright()
    upright.start(counted((0.3, 0.1, -STANDARD_GRAVITY), tally))
    upright, block = instrument(upright, tally), instrument(MountingYaw(), tally)
    entry = Counter()
    for k in range(40):
        tally.clear()
        force = counted((0.6, 0.2, -STANDARD_GRAVITY), tally)
        upright.step(force, Counted(1.0, tally))
        epoch = counted((float(k), 1.0, 0.3, 5.0 + 0.2 * k, 0.01), tally)
        block.step(*epoch, *upright.level(force), *counted((0.001, (0.3, 0.1)), tally))
        if block.straights:
            return tally, entry
        entry = tally.copy()
    raise AssertionError("a steady course gave no straight")


def _fusion(dt):
    """Make a fusion filter that has its model of a step."""
    block = Fusion()
    block.start((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 3.0, 1.0)
    block.predict((0.1, 0.0, 0.0), dt, 0.3)
    return block
