"""The Kalman filter step that blocks 2 and 6 share.

Nothing but operators on arrays, so that the same code runs in float64, in float32, and on object
arrays whose entries count what is done with them: `analysis.tracker.operations` counts these lines
and no copy of them.
"""

import numpy as np


def predict(x, P, F, Q, u=None, B=None):
    """Carry state and covariance over one step.

        x = F x + B u,    P = F P F' + Q

    With the input added without a matrix (``B`` left out, n = p) this is the prediction whose 54
    sums and 63 products Table I prints for [n, m, p] = [3, 3, 3]; with ``B`` it is the one of
    [9, 5, 3].

    Parameters
    ----------
    x : ndarray, shape (n,)
    P, F, Q : ndarray, shape (n, n)
    u : ndarray, shape (p,), optional
        Input.
    B : ndarray, shape (n, p), optional

    Returns
    -------
    x, P : ndarray
    """
    x = F @ x
    if u is not None:
        x = x + (u if B is None else B @ u)
    return x, F @ P @ F.T + Q


def update(x, P, z, H, R):
    """Take in one measurement z = H x + noise of covariance R.

        S = H P H' + R,  K = P H' S^-1,  x = x + K (z - H x),  P = P - K H P

    The last line is followed by the mean of P and its transpose, so that rounding cannot make P
    unsymmetric.

    Parameters
    ----------
    x : ndarray, shape (n,)
    P : ndarray, shape (n, n)
    z : ndarray, shape (m,)
    H : ndarray, shape (m, n)
    R : ndarray, shape (m, m)

    Returns
    -------
    x, P : ndarray
    innovation : ndarray, shape (m,)
    """
    HP = H @ P
    K = HP.T @ inverse(HP @ H.T + R)
    innovation = z - H @ x
    x = x + K @ innovation
    P = P - K @ HP
    return x, 0.5 * (P + P.T), innovation


def inverse(S):
    """Invert a symmetric positive matrix by its Cholesky factors S = L D L'.

    The form without square roots: they are dear on a small processor.

    Parameters
    ----------
    S : ndarray, shape (m, m)
        Only its lower triangle is read.

    Returns
    -------
    ndarray, shape (m, m)
        Symmetric.

    Raises
    ------
    ZeroDivisionError or FloatingPointError
        If S is singular, which a measurement noise above zero excludes.
    """
    rows = [scalars(row) for row in S]
    m = len(rows)
    # L in place below the diagonal, 1/D on it.
    for j in range(m):
        row = rows[j]
        scaled = [row[k] * rows[k][k] for k in range(j)]  # L[j, k]
        pivot = row[j]
        for k in range(j):
            pivot = pivot - scaled[k] * row[k]
        for i in range(j + 1, m):
            below = rows[i]
            entry = below[j]
            for k in range(j):
                entry = entry - below[k] * scaled[k]
            below[j] = entry  # L[i, j] D[j], scaled when its own row comes
        rows[j] = [*scaled, 1 / pivot]
    # inv(L), row by row below its unit diagonal.
    lower = [[None] * m for _ in range(m)]
    for i in range(m):
        for j in range(i):
            entry = rows[i][j]
            for k in range(j + 1, i):
                entry = entry + rows[i][k] * lower[k][j]
            lower[i][j] = -entry
    result = np.empty((m, m), dtype=S.dtype)
    for i in range(m):
        for j in range(i + 1):
            entry = rows[i][i] if i == j else lower[i][j] * rows[i][i]
            for k in range(i + 1, m):
                entry = entry + lower[k][i] * (rows[k][k] * lower[k][j])
            result[i, j] = result[j, i] = entry
    return result


def scalars(array):
    """Return the entries of a vector as scalars of its own number type.

    In float64 Python's floats, which are the same and several times faster.
    """
    return array.tolist() if array.dtype == np.float64 else list(array)
