"""The pages of a training, of methods and of models compared, and of the accelerometers' diagnosis."""
