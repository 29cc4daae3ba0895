"""Results: the plain records of the analyses, which here print, show, plot and give DataFrames."""
