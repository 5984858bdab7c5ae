"""Files into arrays, one format per module: these modules know no grid and no map."""
