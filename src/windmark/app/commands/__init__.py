"""Commands and their options, by subject; `cli` puts them together. Heavy imports wait until a verb runs."""
