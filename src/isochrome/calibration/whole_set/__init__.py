"""All images of a calibration in one model: their common light, exposures, lens and tone."""
