"""Slip rate, traction and friction along a whole interface from sensors, with exact Gaussian uncertainty.

Bodies are linear, so that every sensor is a convolution of the slip rate of the interface with its impulse responses,
plus its response to known loads. One backward run per channel gives the impulse responses at all points of the
interface; they do not depend on the friction law. With a Gaussian prior of the slip rate and Gaussian noise the
posterior is Gaussian and exact.
"""
