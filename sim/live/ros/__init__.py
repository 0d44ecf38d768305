"""ROS: `messages` makes and reads the fields of ROS messages, `link` exchanges them with a rosbridge over a websocket.

Places are the world's, in metres and seconds, as ROS has them; no part of ROS is needed here.
"""
