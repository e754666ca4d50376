"""How the arm gets on, tick by tick: its motions, the way of its elbow, what is recorded."""
