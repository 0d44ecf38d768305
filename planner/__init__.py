"""Where to sense next: the workspace of poses, acquisition functions, planners."""
