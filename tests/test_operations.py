"""Operation counts: by formula, and on the code as it runs."""

import math
from collections import Counter

import numpy as np
import pandas as pd
import pytest

from analysis import DATA
from analysis.tracker import at_rest, operations
from analysis.tracker.constrained import Constrained
from analysis.tracker.operations import Counted, counted, instrument


def lean_update(n, m):
    """Count the update of `kalman` by formula: nothing is multiplied out twice. ::

    K = (H P)' inv(H P H' + R)     P = P - K (H P), then the mean of P and its transpose
    """
    state, S, gain = [(m, n, 1), (n, m, 1)], [(m, n, n), (m, n, m)], [(n, m, m), (n, m, n)]
    lean = operations.dense(state + S + gain, m + n + m * m + 2 * n * n)
    # The inverse by S = L D L', without square roots, as `kalman` does it.
    pairs, triples = m * (m - 1) // 2, (m**3 - 3 * m**2 + 2 * m) // 6
    squares = (m - 1) * m * (2 * m - 1) // 6
    factor = Counter(sums=triples + pairs, products=triples + 2 * pairs, divisions=m)
    inverse = factor + Counter(sums=squares, products=squares + pairs)
    return lean + inverse + Counter(products=n * n)


def buffer_mean(length, axes=1):
    """Count the mean of a buffer from scratch: one division an axis."""
    return Counter(sums=axes * (length - 1), divisions=axes)


def printed(block, portion):
    """Look up sums and products of a row of Table I."""
    table = pd.read_csv(DATA / "published" / "tracker-table-1.csv", comment="#")
    row = table[(table["block"] == block) & (table["portion"] == portion)].iloc[0]
    return row["sums"], row["products"]


def test_predictions_are_those_of_table_one():
    """published: 54 sums and 63 products without B, 1476 and 1566 with it.

    Of the textbook's update 207 products for [3, 3], its 9 divisions among them (25 for [9, 5]);
    the other three do not follow.
    """
    three, nine = operations.predict(3, 3, input_matrix=False), operations.predict(9, 3)
    assert three - operations.predict(3, 0) == Counter(sums=3)  # the input that is not there
    for block, portion, found, divisions, sums, products in (  # how much more is printed
        (2, "Predict 1", three, 0, 0, 0), (2, "Update", operations.update(3, 3), 9, 6, 0),
        (6, "Predict", nine, 0, 0, 0), (6, "Update", operations.update(9, 5), 25, 175, 285),
    ):  # fmt: skip
        ours = found["sums"] + sums, found["products"] + divisions + products
        assert (found["divisions"], *ours) == (divisions, *printed(block, portion))


@pytest.mark.parametrize("m", [1, 2, 3, 5, 8])
def test_cholesky_inverse_runs_as_counted(m):
    """cross-check: a plain Cholesky inverse, run on counting numbers, costs that much."""
    tally, A = Counter(), np.random.default_rng(m).standard_normal((m, m))
    S = A @ A.T + np.eye(m)
    L, inv, full = counted(S, tally), np.zeros((m, m), dtype=object), np.zeros((m, m))
    for j in range(m):
        for k in range(j):
            L[j:, j] = L[j:, j] - L[j:, k] * L[j, k]
        L[j, j] = counted(math.sqrt(float(L[j, j])), tally)
        tally["functions"] += 1
        L[j + 1 :, j] = L[j + 1 :, j] / L[j, j]
    for j in range(m):
        inv[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, m):
            inv[i, j] = -(L[i, j:i] * inv[j:i, j]).sum() / L[i, i]
    for i in range(m):
        for j in range(i + 1):
            full[i, j] = full[j, i] = float((inv[i:, i] * inv[i:, j]).sum())
    np.testing.assert_allclose(full @ S, np.eye(m), atol=1e-9)  # rounding of a random matrix
    assert tally == operations.cholesky_inverse(m)


def test_counting_changes_no_value():
    """property: counted numbers compute what floats do, and each operation is counted once."""
    tally = Counter()
    a, b = Counted(3.0, tally), Counted(-2.0, tally)
    found = (a + b) * 2 - 1 / a + (1 - b) ** 2 + -b + 2.0 * a / b
    assert float(found) == pytest.approx(2 - 1 / 3 + 9 + 2 - 3)
    assert tally == Counter(sums=6, products=3, divisions=2)
    before = tally.copy()
    assert a > b and b < 0 and a >= 3 and b <= -2 and a == 3.0
    assert tally == before


def kinds(steps, block, step):
    """Return the operations of one step kind by kind."""
    return Counter(steps.loc[(block, step), list(operations.KINDS)].to_dict())


@pytest.fixture(scope="module")
def steps():
    """Count every step once."""
    return operations.block_costs()


@pytest.mark.parametrize("sizes", [(3, 3, 3), (9, 5, 3), (2, 1, 1), (6, 4, 2), (1, 1, 1)])
def test_filter_steps_are_those_of_the_formulas(sizes):
    """cross-check: the kernel on counting numbers against the formulas of another module."""
    n, m, p = sizes
    predict, update = operations.filter_costs(n, m, p, input_matrix=True)["counted"].values()
    assert predict == operations.predict(n, p) and update == lean_update(n, m)


def test_filters_cost_a_fraction_of_their_formulas(steps):
    """analytic: a sample is 3 axes of 4 sums and 2 products, half a step and the time in waiting.

    A fix carries two covariances and takes in five numbers. For the attitude one number for P is
    cheaper than the two predictions and the update of Table I.
    """
    inside = operations.predict(3, 0) + operations.predict(3, 0) + lean_update(3, 3)
    assert 50 < kinds(steps, "2", "sample").total() < inside.total() / 2
    assert kinds(steps, "6", "sample") == Counter(sums=3 * 4 + 1, products=3 * 2 + 1)
    assert kinds(steps, "6", "fix").total() < lean_update(9, 5).total() / 10


def test_blocks_three_and_four_cost_their_means(steps):
    """analytic: n places, two coordinates: 2 (n - 1) sums and 2 divisions; at worst all layers.

    Of eight means of six numbers the mean, the squares of what they are off, and T of their sums.
    Two sums tell whether a second has passed.
    """
    six, off = buffer_mean(8, axes=6), Counter(sums=2 * 48, products=48)
    scaled = Counter(products=6) + Counter(sums=2 + 2 + 1, divisions=3)
    assert kinds(steps, "3", "window of 0.25 s means") == six + off + scaled
    assert kinds(steps, "3", "fix") == Counter(sums=5 + 2, divisions=1)
    # Two running means by a share of the step, and the square of their norm.
    assert kinds(steps, "3", "sample") == Counter(sums=2 * 2 + 1, products=2 + 2, divisions=1)
    first, second, third = (buffer_mean(n, axes=2) for n in at_rest.LowPass.lengths)
    assert kinds(steps, "4", "fix that fills layer 1") == first
    assert kinds(steps, "4", "fix that fills layer 3") == first + second + third
    # The distance of the fix from the output, squared.
    assert kinds(steps, "4", "fix") == Counter(sums=4, products=3)


def test_how_often_steps_come(steps):
    """analytic: fixes of 1 Hz, samples of 40; eight fill a step of P, 30 x 30 x 3 fixes a layer."""
    often = {"fix": 1, "straight": 1 / 6, "window of 0.25 s means": 4, "step of P": 5}
    often |= {f"fix that fills layer {k}": n / 2700 for k, n in ((1, 87), (2, 2), (3, 1))}
    for (_, step), found in steps["times_a_second"].items():
        assert found == pytest.approx(often.get(step, 40.0))
    block, under, tally = Constrained(), operations.under_way(1 / 40), Counter()
    block.start((0.1, 0.2), (5.0, 0.1), (under.C_nb, under.bias.x, under.down), 0.1, 3.0, 0.3)
    instrument(block, tally)
    for _ in range(8):
        block.sample(*counted(((0.0, 0.0, 0.1), (0.3, 0.0, -9.8), 1 / 40), tally))
    sample, step = (kinds(steps, operations.FOR_CARS, name) for name in ("sample", "step of P"))
    assert tally.total() == 8 * sample.total() + step.total()
    # Seven means, the force, its weight, and the share of the upright mean.
    assert kinds(steps, "5", "fix")["divisions"] == 7 + 3
