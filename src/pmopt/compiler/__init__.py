"""From kernel text to machine code that is kept."""
