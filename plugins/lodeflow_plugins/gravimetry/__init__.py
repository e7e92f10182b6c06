"""Corrections of gravity that is measured on a ship or an aircraft."""
