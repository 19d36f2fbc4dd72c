"""Meshes to primitive sets: reads glTF scenes and approximates them with analytic SDF primitives."""
