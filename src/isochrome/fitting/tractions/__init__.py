"""Surface tractions from a frame, without a contact model."""
