"""Geometric mistakes put into the code on purpose, to see that the tests notice each of them."""
