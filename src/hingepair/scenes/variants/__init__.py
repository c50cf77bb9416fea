"""Many variants of a scene: numbers varied, swept, searched for, and their tolerances."""
