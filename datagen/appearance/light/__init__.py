"""The light of synthetic photographs: environments, lamps, shadows and ambient occlusion."""
