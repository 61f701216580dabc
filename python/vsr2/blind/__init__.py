"""The blind check: campaigns whose effect is withheld, their diagnosis, and its scores."""

from vsr2.blind.custodian.pack_making import is_begun, make_pack
from vsr2.blind.form.pack_settings import PackSettings, Tolerances
from vsr2.blind.pack_diagnoses import diagnose_pack
from vsr2.blind.scoring.packs import score_pack

__all__ = [
    "PackSettings",
    "Tolerances",
    "diagnose_pack",
    "is_begun",
    "make_pack",
    "score_pack",
]
