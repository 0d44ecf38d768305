"""When to stop: how many lesions were found, how many could still hide, and whether looking for them is worth it.

It judges by what could hide in the light of the readings, whichever planner chose the poses.
"""
