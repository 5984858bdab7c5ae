"""Components of the cells of a map, block by block, so that a change asks for few of them."""
