"""Looking at shards: sheets, pages, statistics, cards."""
