"""Kernel text: plain Python on floats and arrays, compiled by :mod:`pmopt.compiler`."""
