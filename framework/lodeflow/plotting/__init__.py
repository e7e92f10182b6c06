"""Time series of recordings as figures: what to draw, read by column, thinned, drawn."""
