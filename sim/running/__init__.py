"""Running one episode: its options, its folder with progress, frames and report, and what it adds up to."""
