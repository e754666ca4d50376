"""How it is answered: the solver, its verbs, and the loop behind them."""
