"""The command that a page prints is what the study beside it does."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import pytest

from planted import shaken_campaign
from vsr2.campaign import save_campaign
from vsr2.causes.margins.simulated_scenes import SCENES
from vsr2.cli.main import main
from vsr2.ensemble import Hypotheses
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
from vsr2.errors import DiagnosisError

ROOT = Path(__file__).resolve().parents[2]
STUDY = ROOT / "studies" / "lab_several_causes.py"
SCENE = """
name: block
engine: {mode: fast}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion: {mode: single_cosine, pga_g: 0.3, pgv_pga_s: 0.1}
"""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a search for causes is asked, which then ends."""
    found: dict[str, Any] = {}

    def stop(campaign: object, scene: object, **how: Any) -> None:
        found.clear()
        found.update(how)
        raise DiagnosisError("seen enough")

    monkeypatch.setattr("vsr2.causes.find_causes", stop)
    return found


def question(asked: dict[str, Any]) -> tuple[object, ...]:
    """All that changes what is found."""
    given: Hypotheses = asked["hypotheses"]
    return (
        asked["scenes"] or SCENES.usual, asked["seed"], sorted(given.exclude),
        tuple(given.contact_family), tuple(given.nuisances), dict(given.priors), given.library,
    )  # fmt: skip


def searched(tmp_path: Path, *options: str) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    save_campaign(shaken_campaign(2, 1, duration=1.0), tmp_path / "campaign", overwrite=True)
    assert main(["campaign", "causes", str(scene), str(tmp_path / "campaign"), *options]) == 2


def test_the_printed_search_for_causes_is_the_study(
    asked: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "explanation" / "real_campaign.md").read_text()
    [line] = re.findall(r"^vsr2 campaign causes (.+)$", page, re.M)
    scene, campaign, *options = shlex.split(line)
    assert (scene, campaign) == ("studies/lab_diagnosis.yaml", "out/lab")
    at = options.index("--out")
    del options[at : at + 2]
    # The page's figures are those of a seed that the study is run with.
    at = options.index("--seed")
    monkeypatch.setattr("sys.argv", [STUDY.name, *options[at : at + 2]])
    with pytest.raises(DiagnosisError, match="seen enough"):
        runpy.run_path(str(STUDY), run_name="__main__")
    by_study = question(asked)
    searched(tmp_path, *options)
    assert question(asked) == by_study
    del options[at : at + 2]
    assert f"`vsr2 campaign causes {scene} {campaign} {' '.join(options)}`" in " ".join(
        STUDY.read_text().split()
    )


def test_contact_models_are_drawn_unless_one_is_asked_for(
    asked: dict[str, Any], tmp_path: Path
) -> None:
    searched(tmp_path)
    assert tuple(asked["hypotheses"].contact_family) == CONTACT_FAMILY
    searched(tmp_path, "--one-contact-model", "--exclude", "wear")
    assert tuple(asked["hypotheses"].contact_family) == ()
    assert tuple(asked["hypotheses"].exclude) == ("wear",)
