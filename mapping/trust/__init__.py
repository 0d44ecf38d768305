"""How far labels can be believed: the rates at which a sensor errs, told or learnt, and what they make of a reading."""
