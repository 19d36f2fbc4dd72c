"""Scenes and primitive sets to frames: the wgpu renderer and its global illumination techniques."""
