"""Ground motions: one type, readers, processing, intensity measures, fusion of channels."""

from vsr2.config.motion_source import Channel
from vsr2.motion.cosine import cosine_measures, cosine_motion, cosine_parameters
from vsr2.motion.fusion import (
    ChannelNoise,
    FusedMotion,
    InputUncertainty,
    Noise,
    channel_noise,
    fuse,
    input_uncertainty,
)
from vsr2.motion.measures import (
    IntensityMeasures,
    arias_intensity,
    cumulative_absolute_velocity,
    intensity_measures,
    kinematics,
    pga_g,
    pgv_m_s,
    significant_duration,
)
from vsr2.motion.motion import Motion, SideMotion
from vsr2.motion.processing import band_pass, remove_baseline
from vsr2.motion.record import Record
from vsr2.motion.record_on_file import on_file
from vsr2.motion.recording import RecordFormat, read_record, write_record
from vsr2.motion.resample import resample
from vsr2.motion.signal_motion import from_signal
from vsr2.motion.spectrum import ResponseSpectrum, response_spectrum
from vsr2.motion.study_motions import (
    MotionWarning,
    Recorded,
    build_motions,
    build_recorded_motion,
    warn_of_unusual_pga,
)
from vsr2.motion.synthetic import shaped_noise, synthetic_motion
from vsr2.motion.two_components import rotated, rotd, rotd_pga_g
from vsr2.motion.units import STANDARD_GRAVITY

__all__ = [
    "STANDARD_GRAVITY",
    "Channel",
    "ChannelNoise",
    "FusedMotion",
    "InputUncertainty",
    "IntensityMeasures",
    "Motion",
    "MotionWarning",
    "Noise",
    "Record",
    "RecordFormat",
    "Recorded",
    "ResponseSpectrum",
    "SideMotion",
    "arias_intensity",
    "band_pass",
    "build_motions",
    "build_recorded_motion",
    "channel_noise",
    "cosine_measures",
    "cosine_motion",
    "cosine_parameters",
    "cumulative_absolute_velocity",
    "from_signal",
    "fuse",
    "input_uncertainty",
    "intensity_measures",
    "kinematics",
    "on_file",
    "pga_g",
    "pgv_m_s",
    "read_record",
    "remove_baseline",
    "resample",
    "response_spectrum",
    "rotated",
    "rotd",
    "rotd_pga_g",
    "shaped_noise",
    "significant_duration",
    "synthetic_motion",
    "warn_of_unusual_pga",
    "write_record",
]
