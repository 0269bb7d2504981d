"""Recipes of vehicles, trees and street furniture."""
