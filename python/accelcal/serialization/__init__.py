"""Files and JSON of models and diagnoses."""
