"""Maps written for other programs: ROS maps, VTK images, and the border of the free space as a mesh."""
