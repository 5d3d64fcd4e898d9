"""From what is asked to how it is done: options, the plan, what it will cost and how far it can be wrong."""
