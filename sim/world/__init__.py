"""What exists: anatomy, scene, arm, kinematics, probe, rendering."""
