"""Route A: emulators of the response, evidence of effects and pairs, classes that look alike."""
