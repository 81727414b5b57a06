"""Files that mean something and mean ill: for each reader a grammar of what its files hold."""
