; Names are those of Neovim and Zed; docs/editors.md has a line that makes those of Helix.
; Where two patterns fit the same node, the later one counts.

(identifier) @variable

[
  "import" "as" "let" "param" "fn" "native" "loss" "optimize" "stage" "then" "every" "save" "to" "print" "plot"
  "over" "expect" "report" "sweep" "test" "with" "in" "for"
] @keyword
(kind_word) @keyword
["if" "else"] @keyword
["and" "or" "not" "within" "of"] @keyword.operator

(module_path (identifier) @module)
(import alias: (identifier) @module)

(function name: (identifier) @function)
(native_function name: (identifier) @function)
(call function: (identifier) @function.call)
(call function: (member name: (identifier) @function.call))

(parameter name: (identifier) @variable.parameter)
(lambda parameters: (identifier) @variable.parameter)
(lambda_parameters (identifier) @variable.parameter)
(named_argument name: (identifier) @variable.parameter)
(for name: (identifier) @variable.parameter)

(member name: (identifier) @property)
(call function: (member name: (identifier) @function.call))
(field name: (identifier) @property)
(entry name: (identifier) @property)
(type_field name: (identifier) @property)
(reported name: (identifier) @property)

(type_name) @type
(word_type) @string.special

(boolean) @boolean
(number) @number
(unit) @type.builtin
(color) @constant

(string) @string
(escape) @string.escape
(format) @string.special
(interpolation ["{" "}"] @punctuation.special)

["=" "==" "!=" "<" "<=" ">" ">=" "≈" "~=" "~" "+" "-" "*" "/" "@" "^" ".." "..=" "|" "|>" "=>"] @operator
(domain_dots) @operator
["(" ")" "[" "]" "{" "}"] @punctuation.bracket
["," ":" "."] @punctuation.delimiter

(comment) @comment
(block_comment) @comment
(doc_comment) @comment.documentation
