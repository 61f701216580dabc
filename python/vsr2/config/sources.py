"""Where defaults come from: a publication, an engine, a measurement, or why one was chosen.

A key of a section carries its source as metadata, `Annotated[float, BULLET] = 0.2`, and the
reference of keys prints it.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic.fields import FieldInfo


@dataclass(frozen=True)
class Source:
    """Where a default comes from.

    Attributes:
        text: for the reference of keys, Markdown of one line.
    """

    text: str


def source_of(field: FieldInfo) -> str:
    """The source of a key's default; empty: it states none."""
    return next((one.text for one in field.metadata if isinstance(one, Source)), "")


NEUTRAL = Source("neutral: changes nothing")
OFF = Source("off, until asked for")

BULLET = Source("Bullet's own default")
PYBULLET = Source("PyBullet's own default for shapes")
ORIGINAL_SETUP = Source("as in the original system")
SUPPLEMENT_SOLVER = Source("supplement S1.2, the original's setting")
SUPPLEMENT_CONTACT = Source(
    "supplement Table S1, best of the original's calibration; state your own where measured"
)

CONVERGED = Source(
    "physical: what the sweeps of Bullet lead to in the end "
    "([measured](../validation/engines.md#the-nominal-scene-against-mujoco))"
)
QUIET = Source(
    "no outcome changes beyond chance ([measured](../validation/engines.md#quiet-stretches))"
)
GRAVITY = Source("standard gravity 9.80665, rounded as in the original system")
TIME_STEP = Source(
    "supplement S1.2; a motion that overturns is 1 to 2 % stronger than at 0.25 ms "
    "([measured](../validation/engines.md#what-a-time-step-costs))"
)
EVERY_SWEEP = Source("every sweep is made, so that no result hangs on a tolerance")
NO_DAMPING = Source(
    "physical: a rock loses its energy in impacts "
    "([why](../explanation/contact_model.md#habits-of-the-original-system))"
)
POINT_CONTACT = Source(
    "physical: the limit of a point "
    "([why](../explanation/contact_model.md#habits-of-the-original-system))"
)
PEDESTAL_SIZE = Source("chosen: wider than most rocks travel; only its top is touched")
PEDESTAL_MASS = Source("chosen: some hundred times a rock's, which then hardly drives it back")
BASE_SIZE = Source("chosen: longer than the travel of a strong record; nothing touches it")

CALM = Source("chosen: a drift over the window of a quarter of a millimetre, half a milliradian")
SETTLING_TIMEOUT = Source("chosen: rocks settle in some seconds; a minute says that one does not")
TAIL = Source("chosen: rocking blocks of some metres come to rest well within")
REST = Source("chosen: at this speed a block of a metre rocks by less than a milliradian")
REST_WINDOW = Source("chosen: swings near rest are far shorter")
OVERTURNED = Source("chosen: 80 degrees, beyond the point of balance of any rock that stands")
TOPPLED = Source("chosen: 20 degrees, more than a rock that stands on its foot again leans by")
ROCKED = Source("chosen: 0.6 degrees, above what settling and contact softness leave")
SLID = Source("chosen: 5 mm, above what settling leaves, and visible in a laboratory")
ROTATED = Source("chosen: 2 degrees, above what settling leaves, and visible in a laboratory")
LOG = Source("chosen: 100 rows a second at the default step, ten a period at 10 Hz")
ANY_SEED = Source("any number serves")

BAND_PASS = Source(
    "as the laboratory of the 2021 tests filtered its records (Saifullah and Wittich 2023)"
)

EXACT_START = Source("as surveyed: nothing is perturbed until an uncertainty is stated")
USUAL_LEVEL = Source("usual in engineering statistics")
SMOOTH_CURVE = Source("chosen: smooth to the eye; costs no simulation")
REPLICATES = Source("chosen: odd, so that no outcome is tied; few enough to afford in a search")
SUPPLEMENT_SEARCH = Source("chosen: more than the five iterations of supplement Table S2")
SMALLEST_GAIN = Source("chosen: less than one outcome of 582 changes the objective by")
TEN_FOLDS = Source("usual for cross-validation (Kohavi 1995)")
RESAMPLES = Source("usual for percentile intervals (Efron and Tibshirani 1993)")
POWER_OF_TWO = Source("chosen: a power of two, at which a Sobol sequence is even")
REFINE = Source("chosen: a third of the default design")
PROFILE = Source("chosen: few enough to afford, enough to show a curve's shape")
