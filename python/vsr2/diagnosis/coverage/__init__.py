"""Whether a posterior holds what it states, on planted campaigns that training did not see."""
