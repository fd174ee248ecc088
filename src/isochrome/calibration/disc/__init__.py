"""The fringe value from a disc under diametral compression."""
