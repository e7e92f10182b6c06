"""A turntable with two compasses, and magnets and iron cabinets that approach and leave."""
