"""The observed campaign as numbers: outcomes, features of the response, the table's recordings."""
