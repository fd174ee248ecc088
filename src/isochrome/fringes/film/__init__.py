"""Fringe orders followed from frame to frame, without a model of the specimen."""
