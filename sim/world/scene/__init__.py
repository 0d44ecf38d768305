"""The MuJoCo scene: the arms, the composed model, the clearance of arm and probe, room for the base, and pictures."""
