"""The blind check: campaigns whose effect is withheld, their diagnosis, and its scores."""

from vsr2.blind.custodian.make import make_pack
from vsr2.blind.diagnose import diagnose_pack
from vsr2.blind.form.settings import PackSettings, Tolerances
from vsr2.blind.scoring.packs import pool_packs, score_pack

__all__ = [
    "PackSettings",
    "Tolerances",
    "diagnose_pack",
    "make_pack",
    "pool_packs",
    "score_pack",
]
