"""The learning rate of each epoch."""

# From 1e-3 to about 2.1e-5 in the paper.
FINAL_FRACTION = 0.021


def learning_rate(epoch: int, epochs: int, initial: float) -> float:
    """Falls by the same factor from each epoch to the next: initial * 0.021^(epoch / (epochs - 1)).

    The paper says "a fixed schedule" and its two ends; this curve through them is our reading, and it stretches to any
    number of epochs. A single epoch keeps the initial rate.

    Args:
        epoch: From 0.
        epochs: How many there are.
        initial: The rate of epoch 0.

    Source: Crispell and Bazik 2017, Sec. 3.2.
    """
    return initial * FINAL_FRACTION ** (epoch / max(epochs - 1, 1))
