// What takes more than a regular expression: comments within comments, brackets that must open in the line of what they belong to, and
// what stands in a string, where neither white space nor `//` has its meaning.

#include "tree_sitter/parser.h"

// As `externals` in grammar.js has them.
enum Symbol { BLOCK_COMMENT, CALL_OPEN, INDEX_OPEN, STRING_TEXT, NEVER };

void *tree_sitter_dscene_external_scanner_create(void) { return NULL; }
void tree_sitter_dscene_external_scanner_destroy(void *scanner) { (void)scanner; }
unsigned tree_sitter_dscene_external_scanner_serialize(void *scanner, char *buffer) {
  (void)scanner, (void)buffer;
  return 0;
}
void tree_sitter_dscene_external_scanner_deserialize(void *scanner, const char *buffer, unsigned length) {
  (void)scanner, (void)buffer, (void)length;
}

static bool found(TSLexer *lexer, enum Symbol symbol) {
  lexer->mark_end(lexer);
  lexer->result_symbol = symbol;
  return true;
}

// Up to a quote, a backslash, the end of the line or a brace that opens a value; `{{` is a brace.
static bool string_text(TSLexer *lexer) {
  bool is_empty = true;
  while (!lexer->eof(lexer)) {
    int32_t c = lexer->lookahead;
    if (c == '"' || c == '\\' || c == '\n') break;
    lexer->mark_end(lexer);
    lexer->advance(lexer, false);
    if (c == '{') {
      if (lexer->lookahead != '{') {
        lexer->result_symbol = STRING_TEXT;
        return !is_empty;
      }
      lexer->advance(lexer, false);
    }
    is_empty = false;
  }
  return !is_empty && found(lexer, STRING_TEXT);
}

// From its `*`; each one in it ends by itself.
static bool block_comment(TSLexer *lexer) {
  unsigned depth = 1;
  lexer->advance(lexer, false);
  while (depth > 0 && !lexer->eof(lexer)) {
    int32_t c = lexer->lookahead;
    lexer->advance(lexer, false);
    if (c == '/' && lexer->lookahead == '*') {
      depth++;
      lexer->advance(lexer, false);
    } else if (c == '*' && lexer->lookahead == '/') {
      depth--;
      lexer->advance(lexer, false);
    }
  }
  return found(lexer, BLOCK_COMMENT);
}

bool tree_sitter_dscene_external_scanner_scan(void *scanner, TSLexer *lexer, const bool *valid) {
  (void)scanner;
  // While the parser looks for a way out of an error, everything is valid, and nothing is certain.
  bool is_lost = valid[NEVER];
  if (valid[STRING_TEXT] && !is_lost) return string_text(lexer);
  bool is_same_line = true;
  while (lexer->lookahead == ' ' || (lexer->lookahead >= '\t' && lexer->lookahead <= '\r')) {
    if (lexer->lookahead == '\n') is_same_line = false;
    lexer->advance(lexer, true);
  }
  if (lexer->lookahead == '/' && valid[BLOCK_COMMENT]) {
    lexer->advance(lexer, false);
    return lexer->lookahead == '*' && block_comment(lexer);
  }
  if (is_lost || !is_same_line) return false;
  if (lexer->lookahead == '(' && valid[CALL_OPEN]) {
    lexer->advance(lexer, false);
    return found(lexer, CALL_OPEN);
  }
  if (lexer->lookahead == '[' && valid[INDEX_OPEN]) {
    lexer->advance(lexer, false);
    return found(lexer, INDEX_OPEN);
  }
  return false;
}
