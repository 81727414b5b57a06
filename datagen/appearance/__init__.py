"""The appearance of synthetic photographs: skin, hair, accessories, light, backdrop and photograph."""
