"""The order of one monochrome frame, without a model of the specimen."""
