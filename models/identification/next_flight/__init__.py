"""Choose the manoeuvre that best distinguishes the explanations that remain after `identify`."""
