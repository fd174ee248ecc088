"""Which wear law the frames speak for."""
