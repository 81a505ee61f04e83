"""Motion capture: importing, retargeting, looping, splitting."""
