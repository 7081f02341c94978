"""How large an object is in the square pictures that descriptors get, whoever takes them."""

FRAME_FILL = 0.94  # share of the picture's half width that the object's bounding sphere takes
