"""Answers near sensed tumour: the labels that are in play there, and the classifier that asks the nearest of them."""
