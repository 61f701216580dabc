"""Ground motions: one type, four modes, resampling in time, intensity measures."""

from vsr2.motion.build import build_motions, build_recorded_motion
from vsr2.motion.cosine import cosine_measures, cosine_motion, cosine_parameters
from vsr2.motion.measures import STANDARD_GRAVITY, pga, pgv
from vsr2.motion.motion import Motion
from vsr2.motion.processing import band_pass, recorded_pga
from vsr2.motion.recording import Record, read_record
from vsr2.motion.resample import Resampled, resample, sine_error

__all__ = [
    "STANDARD_GRAVITY",
    "Motion",
    "Record",
    "Resampled",
    "band_pass",
    "build_motions",
    "build_recorded_motion",
    "cosine_measures",
    "cosine_motion",
    "cosine_parameters",
    "pga",
    "pgv",
    "read_record",
    "recorded_pga",
    "resample",
    "sine_error",
]
