"""A reader of B-mode pictures: a small network finds the lesions in the planes of a sweep and says how sure it is."""
