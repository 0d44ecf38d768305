"""What exists: organs and what lies in them, arms and the scene they stand in, and how they move and sense.

Nothing here knows a program. The rooms import each other in one direction, each only from those before it: errors,
memory, optional packages and frames; solids; meshes; volumes; anatomy; scene; ik; motion; sensing.
"""
