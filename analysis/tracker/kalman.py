"""The Kalman filter step with dense matrices, as the tracker paper's Table I counts it.

The blocks leave out the products by zeros (`attitude`, `fusion`), so they do not run it. Tests hold
them against it, and `analysis.tracker.operations` counts it: nothing but operators on arrays, so
that entries may be numbers that count what is done with them.
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
    x = F.dot(x)  # on 3 x 3 three times faster than F @ x
    if u is not None:
        x = x + (u if B is None else B.dot(u))
    return x, F.dot(P).dot(F.T) + Q


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
    """
    HP = H.dot(P)
    K = HP.T.dot(inverse(HP.dot(H.T) + R))
    P = P - K.dot(HP)
    return x + K.dot(z - H.dot(x)), 0.5 * (P + P.T)


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
    A = S.tolist() if S.dtype == np.float64 else [list(row) for row in S]
    m = len(A)
    for i, row in enumerate(A):  # row by row: L below the diagonal, 1/D on it
        for j in range(i):
            entry, above = row[j], A[j]
            for k in range(j):
                entry = entry - row[k] * above[k]
            row[j] = entry  # L[i, j] D[j], until the pivot is known
        pivot = row[i]
        for j in range(i):
            scaled = row[j] * A[j][j]
            pivot = pivot - row[j] * scaled
            row[j] = scaled
        row[i] = 1 / pivot
    X = [[None] * m for _ in range(m)]  # from X L = L'^-1 D^-1, last column first
    for j in reversed(range(m)):
        for i in range(j + 1, m):
            entry = -(X[i][j + 1] * A[j + 1][j])
            for k in range(j + 2, m):
                entry = entry - X[i][k] * A[k][j]
            X[i][j] = X[j][i] = entry
        entry = A[j][j]
        for k in range(j + 1, m):
            entry = entry - A[k][j] * X[k][j]
        X[j][j] = entry
    return np.array(X, dtype=S.dtype)
