"""Floating-point errors that a user's program lets NumPy raise do not reach into the project."""

import io

import numpy as np

from foresee import check_predictor, drive, generate, load_predictor, load_world, plot


def test_a_program_in_which_numpy_raises_errors_can_drive_and_plot(short_map):
    with np.errstate(all="raise"):
        run = drive(str(short_map), arms=("predicted",), predictor="extend")
        plot(run).savefig(io.BytesIO())
        assert np.geterr()["under"] == "raise"
    assert [(drive.outcome, drive.faults) for drive in run.episodes] == [("reached", {})]


def test_maps_buildings_and_predictors_do_not_raise_them_either(short_map):
    with np.errstate(all="raise"):
        assert load_world(short_map).grid.free.any()
        assert generate("office", 3).grid.free.any()
        check_predictor(load_predictor("extend"))
