"""The captured facts in the terms of people: names of a plant, facts, text and JSON, devices, expressions that select."""
