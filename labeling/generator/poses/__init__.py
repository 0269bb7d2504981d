"""How well the poses and depths of an episode's views agree, and poses under which they agree better."""
