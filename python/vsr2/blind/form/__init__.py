"""What custodian, diagnosis and scoring share: the files of a pack, their seal and its settings."""
