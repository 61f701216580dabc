"""The custodian: draws effects and magnitudes, simulates on either engine, seals the answer."""
