"""The ways of processing: one function each, imported when it is needed."""
