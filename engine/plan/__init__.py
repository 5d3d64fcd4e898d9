"""From options to a plan: its error bound, its predicted cost, and the choice of the method."""
