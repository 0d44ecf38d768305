"""The folder of a run: written as the run goes, so that an end at any moment leaves a valid one, and read back."""
