"""Pieces of `scenes.py`: five published scenes of Pink and Mink, rebuilt with each library's own calls."""
