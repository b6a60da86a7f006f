"""The Studio: a local web page on which you edit a job and see the resulting robot motion."""
