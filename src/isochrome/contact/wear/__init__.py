"""Wear over the sliding distance: on a mesh that moves with the edges, and on a fixed grid."""
