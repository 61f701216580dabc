"""What a batch gave: outcomes, logs and provenance, and their files."""

from vsr2.results.dataset import to_xarray
from vsr2.results.files import (
    NPY_COLUMNS,
    adopt_trial_log,
    load_result,
    load_trial_log,
    logged_trials,
    original_rows,
    prepare_folder,
    save_result,
    save_trial_log,
)
from vsr2.results.journal import (
    JOURNAL_FILE,
    Journal,
    has_journal,
    read_journal,
    remove_journal,
)
from vsr2.results.models import load_models, save_models
from vsr2.results.provenance import base_provenance, sha256_of_file
from vsr2.results.result import (
    CONTACT_COLUMNS,
    INTEGER_COLUMNS,
    OUTCOMES,
    STATE_COLUMNS,
    STATUSES,
    TEXT_COLUMNS,
    TRIAL_COLUMNS,
    BatchResult,
    TrialLog,
    quaternion_product,
    rotate,
)

__all__ = [
    "CONTACT_COLUMNS",
    "INTEGER_COLUMNS",
    "JOURNAL_FILE",
    "NPY_COLUMNS",
    "OUTCOMES",
    "STATE_COLUMNS",
    "STATUSES",
    "TEXT_COLUMNS",
    "TRIAL_COLUMNS",
    "BatchResult",
    "Journal",
    "TrialLog",
    "adopt_trial_log",
    "base_provenance",
    "has_journal",
    "load_models",
    "load_result",
    "load_trial_log",
    "logged_trials",
    "original_rows",
    "prepare_folder",
    "quaternion_product",
    "read_journal",
    "remove_journal",
    "rotate",
    "save_models",
    "save_result",
    "save_trial_log",
    "sha256_of_file",
    "to_xarray",
]
