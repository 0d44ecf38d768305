"""Mesh files: reading STL, OBJ, PLY, GLB and glTF, repairing what can be repaired, and drawing with fewer triangles."""
