"""Columns of numbers in `trials.csv`."""

NUMBER_COLUMNS = {
    "peak_tilt": "peak_tilt_rad",
    "final_yaw": "final_yaw_rad",
    "final_slip": "final_slip_m",
    "pga_g": "pga_g",
    "pgv_pga_s": "pgv_pga_s",
}
"""By the attribute of a trial."""
