"""The fuzz command's campaign reader runs clean, and its corpus is sound."""

import shutil

import pytest

from fuzz_command import SCRIPT, assert_runs_clean
from vsr2.campaign import check_campaign
from vsr2.errors import CampaignError


def test_the_campaign_reader_runs_clean(tmp_path):
    assert_runs_clean(["campaign"], tmp_path)


def test_the_corpus_is_sound_so_that_mutations_get_past_the_first_check(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    import fuzz_readers

    for name in ("campaign.yaml", "trials.csv"):
        shutil.copy(SCRIPT.parent / "corpus" / "campaign" / name, tmp_path / f"input-{name}")
        fuzz_readers.read_campaign(tmp_path / f"input-{name}")
    # Sound as one of motion and series, so refused as the other, and there only.
    refused = ("series/A2.npz", "motions/pulse.npz")
    for file, (suffix, content) in zip(refused, fuzz_readers.made_seeds("campaign"), strict=True):
        path = tmp_path / f"made{suffix}"
        path.write_bytes(content)
        with pytest.raises(CampaignError):
            fuzz_readers.read_campaign(path)
        assert {one.file for one in check_campaign(tmp_path / "campaign")} == {file}
