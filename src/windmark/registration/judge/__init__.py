"""One judge: explanations of the same spots compete by evidence; what wins is the answer or the reason."""
