"""Proofs that the bodies of an arm stay apart from obstacles, and from each other, in a motion.

They take shapes with poses, and joints as arrays, and give compiled tests of configurations and of
motions. Words that the modules share:

- *body*: links held together by fixed joints; *solid*: a body's surface, or an obstacle.
- *chain*: the bodies of an arm, each after its parent.
- *part*: a connected piece of a body's boundary.
- *tube*: the motion of the joints between two configurations, from which each may deviate.
- *slack*: the excess of a distance over the required distance.
- *cone*: the directions within an angle of a direction, in which a link keeps an axis.
- *inner ball*: a ball inside a solid, which proves collisions.
"""
