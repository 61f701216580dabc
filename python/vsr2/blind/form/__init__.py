"""Common to custodian, diagnosis and scoring: the files of a pack, their seal, its settings."""
