"""The live view draws a stepped simulation where its state says."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vsr2 import Simulation, Study
from vsr2.errors import ResultError, SimulationError
from vsr2.view import LiveView

STUDY = Study.from_dict(
    {
        "rock": {"shape": "box", "size": [0.3, 0.3, 0.8], "density": 2500.0},
        "motion": {"mode": "single_cosine", "pga_g": 0.2, "pgv_pga_s": 0.1},
    }
)


def test_what_is_drawn_stands_where_the_simulation_is() -> None:
    pytest.importorskip("viser")
    simulation = Simulation(STUDY, drive="prescribed")
    simulation.settle()
    with LiveView(simulation) as view:
        assert view.url.startswith("http://127.0.0.1:")
        rock, pedestal = view._drawing._rock, view._drawing._pedestal
        before = np.array(rock.position)
        for i in range(100):
            simulation.step(0.002 * i)
        np.testing.assert_array_equal(rock.position, before)  # until it is updated
        view.update()
        state = simulation.state
        assert np.linalg.norm(state.position - before) > 0.01
        # A box's model frame is its body frame, up to a turn of the axes.
        np.testing.assert_allclose(rock.position, state.position, atol=1e-6)
        np.testing.assert_allclose(pedestal.position, [0.198, 0, 0], atol=1e-6)
        drawn = Rotation.from_quat(np.roll(rock.wxyz, -1))
        up = drawn.apply([0.0, 0.0, 1.0])
        tilt = np.degrees(np.arccos(min(1.0, up[2])))
        # The label has one decimal; the settled rock leans by less than a hundredth.
        assert float(view._drawing._label.text.split("tilt = ")[1].split()[0]) == pytest.approx(
            tilt, abs=0.06
        )
        simulation.delete()
        with pytest.raises(SimulationError):
            view.update()


def test_without_rock_or_viser_there_is_no_view(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SimulationError):
        LiveView(Simulation(STUDY, spawn=False))
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ResultError, match=r"pip install vsr2\[view\]"):
        LiveView(Simulation(STUDY))
