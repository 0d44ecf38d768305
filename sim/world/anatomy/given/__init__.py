"""What files of their own bring to an organ: tumours, bodies of a second class and structures, by one rule.

Whatever the file, mesh or mask, the same is asked of each body: is it large enough, is it the organ itself, and does it
lie where the organ is?
"""
