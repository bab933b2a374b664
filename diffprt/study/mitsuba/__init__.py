"""diffprt's scenes and BRDFs as Mitsuba knows them."""
