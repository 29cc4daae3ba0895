"""Dimensional synthesis: designs that trade the size of a workspace against its dexterity."""
