"""The record of a spraying job: what was applied where, when, by whom, each with its source."""
