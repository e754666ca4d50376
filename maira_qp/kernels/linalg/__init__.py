"""Factorisations of small dense matrices."""
