"""The blind check: campaigns whose effect is withheld, their diagnosis, and its scores."""

from vsr2.blind.diagnose import diagnose_pack
from vsr2.blind.make import make_pack
from vsr2.blind.scoring import pool_packs, score_pack
from vsr2.blind.settings import PackSettings, Tolerances

__all__ = [
    "PackSettings",
    "Tolerances",
    "diagnose_pack",
    "make_pack",
    "pool_packs",
    "score_pack",
]
