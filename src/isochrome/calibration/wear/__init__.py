"""The wear coefficient, from the traces or the volumes of measured scars."""
