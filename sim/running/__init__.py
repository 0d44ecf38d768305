"""Runs of one episode: its options, its parts, its folder with progress, frames and report, and its summary."""
