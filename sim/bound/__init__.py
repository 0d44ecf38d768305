"""The limit of any planner: the fewest poses in hindsight, a bound on every policy, and their certificate."""
