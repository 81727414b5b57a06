"""Commands for morphable models."""
