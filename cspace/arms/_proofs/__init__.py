"""Proofs that the bodies of an arm stay apart from obstacles, and from each other, in a motion.

They take shapes with poses, and joints as arrays, and give compiled tests of configurations and of
motions. Words that the modules share:

- *body*: links held together by fixed joints; *solid*: a body's surface, or an obstacle.
- *chain*: the bodies of an arm, each after its parent.
- *part*: a connected piece of a body's boundary.
- *tube*: the motion of the joints between two configurations, from which each may deviate.
- *slack*: by how much a distance exceeds the one that is required.
- *cone*: the directions within an angle of one that a link keeps.
- *inner ball*: a ball inside a solid, which proves collisions.
"""
