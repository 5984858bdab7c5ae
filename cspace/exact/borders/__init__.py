"""The robot and the obstacles as border pieces, and the distances between them."""
