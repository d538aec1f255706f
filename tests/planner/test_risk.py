"""The clauses of the risk map, and the exactness of the distance field under it."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.ndimage import distance_transform_edt

from foresee.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, GridFrame
from foresee.prediction import Prediction
from planner.risk.distance_transform import distance_field
from planner.risk.risk_map import RiskMap

SHAPE = (7, 9)
FRAME = GridFrame(0.1, (-1.0, 2.0), SHAPE)

risks = st.one_of(st.sampled_from([0.0, 1e-9, 0.1, 0.5, 1.0]), st.floats(0.0, 1.0))
shares = hnp.arrays(np.float32, SHAPE, elements=st.floats(0.0, 1.0, width=32))
shares_or_nan = hnp.arrays(
    np.float32, SHAPE, elements=st.one_of(st.just(np.nan), st.floats(0.0, 1.0, width=32))
)
grids = hnp.arrays(np.int8, SHAPE, elements=st.sampled_from([FREE, OCCUPIED, UNKNOWN])).map(
    lambda cells: Grid(FRAME, cells)
)


def believed(p_free, confidence) -> Prediction:
    return Prediction(FRAME, p_free, np.zeros_like(p_free), confidence)


def safe(known, prediction, epsilon):
    return RiskMap.from_prediction(known, prediction, epsilon).safe


def full(value: float):
    return np.full(SHAPE, value, np.float32)


@given(grids, shares_or_nan, shares_or_nan, risks)
def test_seen_occupied_is_never_safe(known, p_free, confidence, epsilon):
    assert not safe(known, believed(p_free, confidence), epsilon)[known.occupied].any()


@given(grids, shares_or_nan, shares_or_nan, risks)
def test_seen_free_is_always_safe(known, p_free, confidence, epsilon):
    assert safe(known, believed(p_free, confidence), epsilon)[known.free].all()


@given(grids, shares, risks)
def test_zero_confidence_equals_unknown(known, p_free, epsilon):
    distrusted = RiskMap.from_prediction(known, believed(p_free, full(0.0)), epsilon)
    unpredicted = RiskMap.from_prediction(known, None, epsilon)
    assert np.array_equal(distrusted.safe, unpredicted.safe)
    assert np.array_equal(distrusted.trust, unpredicted.trust)
    assert np.array_equal(distrusted.clearance, unpredicted.clearance)


@given(grids, shares_or_nan, shares, risks, risks)
def test_the_safe_set_never_shrinks_as_the_risk_grows(known, p_free, confidence, a, b):
    prediction = believed(p_free, confidence)
    small, large = (safe(known, prediction, e) for e in (min(a, b), max(a, b)))
    assert (small <= large).all()


@given(grids, shares, shares, shares, risks)
def test_the_safe_set_never_shrinks_as_the_probability_of_free_grows(known, p, q, c, epsilon):
    less, more = np.minimum(p, q), np.maximum(p, q)
    small, large = (safe(known, believed(p_free, c), epsilon) for p_free in (less, more))
    assert (small <= large).all()


@given(grids, shares, shares, shares, risks)
def test_the_safe_set_never_shrinks_as_confidence_grows(known, p, c, d, epsilon):
    less, more = np.minimum(c, d), np.maximum(c, d)
    assert (
        safe(known, believed(p, less), epsilon) <= safe(known, believed(p, more), epsilon)
    ).all()


@given(grids, shares_or_nan, shares_or_nan, risks)
def test_a_nan_is_unknown(known, p_free, confidence, epsilon):
    bad = np.isnan(p_free) | np.isnan(confidence)
    with_nan = RiskMap.from_prediction(known, believed(p_free, confidence), epsilon)
    without = RiskMap.from_prediction(
        known, believed(np.nan_to_num(p_free), np.where(bad, 0, confidence)), epsilon
    )
    assert np.array_equal(with_nan.safe, without.safe)
    assert np.isfinite(with_nan.trust).all()
    assert np.isfinite(with_nan.clearance).all()


@given(grids)
def test_at_zero_risk_only_what_was_seen_free_is_safe_however_sure_the_prediction(known):
    assert np.array_equal(safe(known, believed(full(1.0), full(1.0)), 0.0), known.free)


@given(grids)
def test_at_full_risk_everything_not_seen_occupied_is_safe_without_a_prediction(known):
    assert np.array_equal(safe(known, None, 1.0), ~known.occupied)


@given(grids, shares, shares)
def test_at_full_risk_no_prediction_takes_anything_away(known, p_free, confidence):
    assert np.array_equal(safe(known, believed(p_free, confidence), 1.0), ~known.occupied)


@given(
    grids,
    st.one_of(shares_or_nan, st.just(full(1.0))),
    st.one_of(shares_or_nan, st.just(full(1.0))),
    risks,
)
def test_at_level_zero_what_is_certain_was_seen_free_however_sure_the_prediction(
    known, p, c, epsilon
):
    risk = RiskMap.from_prediction(known, believed(p, c), epsilon)
    assert (risk.certain <= risk.safe).all()
    assert risk.plan_suffices == (epsilon in (0.0, 1.0))
    if risk.plan_suffices:
        assert np.array_equal(risk.certain, risk.safe)
    else:
        assert not risk.certain[~known.free].any()
        assert risk.certain[known.free].all()


@given(grids, shares_or_nan, shares_or_nan, st.floats(0.01, 0.99))
def test_at_a_tiny_level_what_is_certain_was_seen_free_or_is_predicted_for_sure(
    known, p, c, epsilon
):
    risk = RiskMap.from_prediction(known, believed(p, c), epsilon, level=1e-9)
    doubted = known.unknown & ~(np.nan_to_num(p * c) >= 1.0 - 1e-5)
    assert not risk.certain[doubted | known.occupied].any()
    assert risk.certain[known.free | (known.unknown & (p * c == 1.0))].all()


@given(grids, shares_or_nan, shares, risks, risks, risks)
def test_what_is_certain_never_shrinks_as_the_level_grows(known, p, c, epsilon, a, b):
    small, large = (
        RiskMap.from_prediction(known, believed(p, c), epsilon, level=level * epsilon).certain
        for level in (min(a, b), max(a, b))
    )
    assert (small <= large).all()


@given(grids, shares, shares, st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_above_level_zero_what_is_believed_firmly_enough_is_certain(known, p, c, epsilon, part):
    level = part * epsilon
    risk = RiskMap.from_prediction(known, believed(p, c), epsilon, level=level)
    assert (risk.certain <= risk.safe).all()
    assert risk.certain[known.free].all()
    assert not risk.certain[known.occupied].any()
    believed_free = known.unknown & (risk.trust >= 1.0 - level)
    doubted = known.unknown & (risk.trust < 1.0 - level - 1e-5)
    assert risk.certain[believed_free].all()
    assert not risk.certain[doubted].any()


@pytest.mark.parametrize("level", [-0.01, 0.2, float("nan")])
def test_a_level_above_the_reliance_is_refused(level):
    with pytest.raises(ValueError, match="level"):
        RiskMap.from_prediction(Grid(FRAME, np.zeros(SHAPE, np.int8)), None, 0.1, level=level)


@pytest.mark.parametrize("epsilon", [-0.01, 1.01, float("nan"), float("inf"), -float("inf")])
def test_a_reliance_outside_zero_to_one_is_refused(epsilon):
    with pytest.raises(ValueError, match="reliance"):
        RiskMap.from_prediction(Grid(FRAME, np.zeros(SHAPE, np.int8)), None, epsilon)


@given(grids, st.integers(-12, 12), st.integers(-12, 12), st.sampled_from([0.01, 0.5, 0.99]))
def test_a_prediction_on_a_shifted_frame_only_speaks_of_the_cells_it_covers(known, r, c, epsilon):
    origin = (FRAME.origin[0] + c * 0.1, FRAME.origin[1] + r * 0.1)
    frame = dataclasses.replace(FRAME, origin=origin)
    ones, zeros = full(1.0), full(0.0)
    risk = RiskMap.from_prediction(known, Prediction(frame, ones, zeros, ones), epsilon)
    rows, cols = np.indices(SHAPE)
    covered = (rows >= r) & (rows < r + SHAPE[0]) & (cols >= c) & (cols < c + SHAPE[1])
    assert np.array_equal(risk.trust, known.free | (known.unknown & covered))
    assert np.array_equal(risk.safe, known.free | (known.unknown & covered))


def test_a_prediction_on_another_lattice_is_refused():
    frame = dataclasses.replace(FRAME, origin=(FRAME.origin[0] + 0.03, FRAME.origin[1]))
    ones = full(1.0)
    with pytest.raises(ValueError, match="lattice"):
        RiskMap.from_prediction(
            Grid(FRAME, np.full(SHAPE, UNKNOWN, np.int8)), Prediction(frame, ones, ones, ones), 0.5
        )


@given(grids, shares, shares, risks)
def test_clearance_is_positive_inside_the_safe_set_and_negative_outside(known, p, c, epsilon):
    risk = RiskMap.from_prediction(known, believed(p, c), epsilon)
    half = 0.5 * FRAME.resolution
    assert (risk.clearance[risk.safe] >= half - 1e-6).all()
    assert (risk.clearance[~risk.safe] <= -half + 1e-6).all()


def test_clearance_crosses_zero_at_the_edge_between_two_cells():
    cells = np.full((9, 40), FREE, np.int8)
    cells[:, 20:] = OCCUPIED
    clearance = RiskMap.from_prediction(
        Grid(GridFrame(0.1, (0.0, 0.0), (9, 40)), cells), None, 0.0
    ).clearance
    assert clearance[4, 19] == pytest.approx(0.05)
    assert clearance[4, 20] == pytest.approx(-0.05)
    assert clearance[4, 17] == pytest.approx(0.25)
    assert clearance[4, 23] == pytest.approx(-0.35)


def test_outside_the_frame_is_not_safe():
    free = Grid(FRAME, np.full(SHAPE, FREE, np.int8))
    for epsilon in (0.0, 0.5, 1.0):
        clearance = RiskMap.from_prediction(free, None, epsilon).clearance
        assert clearance[0] == pytest.approx(0.05)
        assert clearance[:, -1] == pytest.approx(0.05)
        assert clearance[3, 4] == pytest.approx(0.35)


@given(grids)
def test_obstacle_distance_is_that_to_the_edge_of_the_nearest_cell_seen_occupied(known):
    distance = RiskMap.from_prediction(known, None, 1.0).obstacle_distance
    if known.occupied.any():
        expected = (distance_transform_edt(~known.occupied) - 0.5) * FRAME.resolution
        assert np.allclose(distance, expected, atol=1e-5)
    else:
        assert (distance > max(FRAME.size)).all()


@settings(max_examples=300)
@given(hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, max_side=24)))
def test_the_distance_field_equals_scipys_exactly(mask):
    if mask.any():
        exact = distance_transform_edt(~mask).astype(np.float32)
        assert np.array_equal(distance_field(mask), exact)
    else:
        assert np.allclose(distance_field(mask), np.hypot(*mask.shape))


@pytest.mark.parametrize("density", [0.0001, 0.002, 0.05, 0.5, 0.999])
def test_the_distance_field_equals_scipys_exactly_on_large_maps(density):
    rng = np.random.default_rng(3)
    mask = rng.random((301, 517)) < density
    mask[200, 17] = True
    exact = distance_transform_edt(~mask).astype(np.float32)
    assert np.array_equal(distance_field(mask), exact)


def test_the_distance_field_is_exact_on_very_wide_maps():
    mask = np.random.default_rng(3).random((40, 12_000)) < 1e-4
    assert np.allclose(distance_field(mask), distance_transform_edt(~mask), atol=1e-3)


@given(grids, shares_or_nan, shares_or_nan)
def test_what_is_barred_was_seen_occupied_or_is_believed_to_be_rather_not_free(
    known, p_free, confidence
):
    barred = RiskMap.from_prediction(known, believed(p_free, confidence), 0.1).barred
    assert barred[known.occupied].all()
    assert not barred[known.free].any()
    rather_not = ((p_free < 0.5) & (confidence > 0.0))[known.unknown]
    assert np.array_equal(barred[known.unknown], rather_not)


@given(grids)
def test_without_a_prediction_only_what_was_seen_occupied_is_barred(known):
    assert np.array_equal(RiskMap.from_prediction(known, None, 0.1).barred, known.occupied)


@given(grids, shares_or_nan, shares_or_nan, st.floats(0.01, 0.99), st.floats(0.0, 1.0))
def test_a_cautious_map_is_that_of_a_car_that_relies_on_what_is_certain(known, p, c, epsilon, part):
    level = part * epsilon
    cautious = RiskMap.from_prediction(known, believed(p, c), epsilon, level=level).cautious
    alone = RiskMap.from_prediction(known, believed(p, c), level)
    assert np.array_equal(cautious.safe, alone.safe)
    assert np.array_equal(cautious.clearance, alone.clearance)
    assert np.array_equal(cautious.barred, alone.barred)
    assert cautious.plan_suffices
