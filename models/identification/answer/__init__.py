"""Turn a finished search into an answer: reported effects, cross-validated errors, new model."""
