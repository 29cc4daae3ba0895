"""What a mechanism can do: kinematics at a pose, workspace and dexterity over many."""
