"""Commands about many seeds at once, a module each."""
