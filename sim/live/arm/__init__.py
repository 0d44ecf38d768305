"""An arm that somebody else drives: it is sent timed joint paths, and says where it really is.

`controller` is the interface, which a ROS JointTrajectory controller could serve as well; `tcp_controller` speaks to
one in lines of JSON, as `messages` says; `simulated_arm` and `simulated_server` are one for trying and for tests.
`steered_motion` moves a session's arm by a controller, and `arm_carrier` takes it where the session proposes.
"""
